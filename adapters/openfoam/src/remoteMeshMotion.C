// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteMeshMotion.H"
#include "IFstream.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "SHA1Digest.H"
#include "Time.H"
#include "addToRunTimeSelectionTable.H"
#include "knownEntries.H"

#include <cmath>

namespace Foam
{
    defineTypeNameAndDebug(remoteMeshMotion, 0);

    addToRunTimeSelectionTable
    (
        motionSolver,
        remoteMeshMotion,
        dictionary
    );
}


namespace
{

using namespace Foam;

//- The coefficients; FatalIOError if one is unknown
const dictionary& checked(const dictionary& dict, const dictionary& coeffs)
{
    static const wordList known
    ({
        "endpoint", "patches", "method", "onServerLoss", "timeout",
        "computeTimeout", "commit", "atEnd", "durability", "label",
        "secretKey", "serverKey", "evaluation", "onRefusal", "couplingWindow"
    });
    // without their own dictionary they are entries of dynamicMeshDict
    static const wordList ofMesh
    ({
        "dynamicFvMesh", "dynamicFvMeshLibs", "libs", "motionSolverLibs",
        "motionSolver", "solver", "cellZone", "updateControl",
        "updateInterval", "type"
    });
    const word own(remoteMeshMotion::typeName + "Coeffs");
    checkEntries(coeffs, known, dict.found(own) ? wordList() : ofMesh);
    for (const word& key : known)
    {
        if (dict.found(own) && dict.found(key))
        {
            FatalIOErrorInFunction(dict)
                << "the entry " << key << " stands outside of " << own
                << ", where it is not read: move it into " << own
                << exit(FatalIOError);
        }
    }
    return coeffs;
}


//- One of two words; the first one is the default
bool isSecond(const dictionary& coeffs, const word& key, const wordList& words)
{
    const word given(coeffs.lookupOrDefault<word>(key, words[0]));
    if (!contains(words, given))
    {
        FatalIOErrorInFunction(coeffs)
            << key << " is " << words[0] << " or " << words[1] << "; got "
            << given << exit(FatalIOError);
    }
    return given == words[1];
}

//- The zone in the dictionary; "" if there is none
word zoneName(const dictionary& dict)
{
    if (dict.found("cellSet"))
    {
        FatalIOErrorInFunction(dict)
            << "remoteMeshMotion moves a cellZone, not a cellSet" << nl
            << "    make one of it, by topoSet's setToCellZone"
            << exit(FatalIOError);
    }
    const word name(dict.lookupOrDefault<word>("cellZone", "none"));
    return name == "none" ? word() : name;
}


#ifdef OPENFOAM
//- A dictionary with the name under which the motion solver of a zone is
//  registered and written; null if the solver moves the whole mesh
std::unique_ptr<IOdictionary> ofZone
(
    const polyMesh& mesh,
    const IOdictionary& dict
)
{
    const word zone(zoneName(dict));
    if (zone.empty())
    {
        return nullptr;
    }
    const IOobject io
    (
        remoteMeshMotion::typeName + '.' + zone,
        mesh.time().constant(),
        mesh,
        IOobject::NO_READ,
        IOobject::AUTO_WRITE
    );
    return std::unique_ptr<IOdictionary>(new IOdictionary(io, dict));
}
#endif


//- The cells of a zone as a mesh; null without a zone
std::unique_ptr<fvMeshSubset> cellsOf(const polyMesh& mesh, const word& name)
{
    if (name.empty())
    {
        return nullptr;
    }
    const fvMesh& all = refCast<const fvMesh>(mesh);
    #ifdef OPENFOAM
    std::unique_ptr<fvMeshSubset> subset
    (
        new fvMeshSubset(all, mesh.cellZones()[name]) // the base class found it
    );
    #else
    std::unique_ptr<fvMeshSubset> subset(new fvMeshSubset(all));
    subset->setLargeCellSubset(labelHashSet(mesh.cellZones()[name]));
    #endif
    // its faces to other cells form a patch of type empty, which 2D needs
    fvMesh& own = subset->subMesh();
    const polyBoundaryMesh& boundary = own.boundaryMesh();
    List<polyPatch*> patches(boundary.size());
    forAll(boundary, patchi)
    {
        const polyPatch& pp = boundary[patchi];
        patches[patchi] =
            pp.name() == "oldInternalFaces"
          ? new polyPatch
            (
                pp.name(), pp.size(), pp.start(), patchi, boundary,
                polyPatch::typeName
            )
          : pp.clone(boundary, patchi, pp.size(), pp.start()).ptr();
    }
    own.removeFvBoundary();
    own.addFvPatches(patches);
    return subset;
}


//- Registered by the name that coupling adapters look up
std::unique_ptr<volVectorField> newCellDisplacement(const polyMesh& mesh)
{
    return std::unique_ptr<volVectorField>
    (
        new volVectorField
        (
            IOobject
            (
                "cellDisplacement",
                mesh.time().timeName(),
                mesh,
                IOobject::NO_READ,
                IOobject::NO_WRITE
            ),
            refCast<const fvMesh>(mesh),
            dimensionedVector(dimLength, Zero)
        )
    );
}

} // End anonymous namespace


const Foam::polyMesh& Foam::remoteMeshMotion::own() const
{
    return zone_ ? zone_->subMesh() : mesh();
}


Foam::tmp<Foam::pointField> Foam::remoteMeshMotion::ofOwn
(
    const pointField& all
) const
{
    return
        zone_
      ? tmp<pointField>(new pointField(all, zone_->pointMap()))
      : tmp<pointField>(all);
}


void Foam::remoteMeshMotion::toAll(const pointField& own, pointField& all) const
{
    if (zone_)
    {
        all = Zero; // of a patch that the zone shares with other cells, too
        UIndirectList<point>(all, zone_->pointMap()) = own;
    }
    else
    {
        all = own;
    }
}


Foam::fileName Foam::remoteMeshMotion::folder(const word& instance) const
{
    const fileName uniform(mesh().time().path()/instance/"uniform");
    return uniform/(zone_ ? word(typeName + '.' + zoneName_) : typeName);
}


Foam::string Foam::remoteMeshMotion::digest() const
{
    dictionary sent;
    sent.add("patches", coeffDict().subDict("patches"));
    sent.add("method", coeffDict().subOrEmptyDict("method"));
    if (zone_)
    {
        sent.add("cellZone", zoneName_);
    }
    if (evaluates_)
    {
        sent.add("evaluation", word("client"));
    }
    return sent.digest().str();
}


void Foam::remoteMeshMotion::open()
{
    string label(mesh().time().globalCaseName());
    if (coeffDict().found("label"))
    {
        // with quotes or without
        const token given(coeffDict().lookup("label"));
        label = given.isWord() ? given.wordToken() : given.stringToken();
    }
    session_->open(remoteMesh_, label);
    Info<< "remoteMeshMotion: a new session" << endl;
}


bool Foam::remoteMeshMotion::isWhereItWas()
{
    scalarField rows;
    session_->committed(rows);
    const pointField here(ofOwn(mesh().points()));
    pointField now(here);
    remoteMesh_.toPoints(rows, now);
    // a time that was written with few digits is still the same time
    const scalar allowed = 1e-5*mesh().bounds().mag();
    const scalar most = gMax(mag(now - here)());
    return most <= allowed;
}


bool Foam::remoteMeshMotion::resume()
{
    const fileName path(folder(mesh().time().timeName()));
    bool found = isFile(path/"state");
    Pstream::scatter(found);
    if (!found)
    {
        return false;
    }
    label step = 0, ranks = 0;
    string settings;
    scalar window = window_;
    List<scalarList> trial;
    if (Pstream::master())
    {
        const dictionary saved(IFstream(path/"state")());
        step = required<label>(saved, "step");
        ranks = required<label>(saved, "processors");
        settings = required<string>(saved, "settings");
        saved.readIfPresent("couplingWindow", window);
        saved.readIfPresent("trial", trial);
    }
    Pstream::scatter(step);
    Pstream::scatter(ranks);
    Pstream::scatter(settings);
    Pstream::scatter(window);
    Pstream::scatter(trial);
    bool same = ranks == Pstream::nProcs() && settings == digest();
    reduce(same, andOp<bool>()); // each rank may read a dictionary of its own
    scalarField rows;
    const bool moved = same && !trial.empty();
    if (moved)
    {
        rows = trial[Pstream::myProcNo()];
    }
    if
    (
        !same
     || !session_->resume
        (
            path/"credentials", step, moved ? &rows : nullptr, remoteMesh_
        )
     || !isWhereItWas()
    )
    {
        WarningInFunction
            << "the session of " << path << " cannot be resumed: "
            << (
                   same
                 ? "it has continued since, or it or its credentials were deleted"
                 : "it had other settings, patches or processors"
               )
            << nl << "    A new one begins with the mesh of this time, "
            << "against which sizes of cells are judged from now on" << endl;
        session_.reset(new remoteSession(coeffDict()));
        return false;
    }
    window_ = window;
    first_ = -1;
    session_->reference(rows);
    const pointField first(ofOwn(points0()));
    pointField reference(first);
    remoteMesh_.toPoints(rows, reference);
    offset_ = reference - first;
    Info<< "remoteMeshMotion: the session goes on after step "
        << session_->step() << endl;
    return true;
}


Foam::label Foam::remoteMeshMotion::stepNow() const
{
    const Time& time = mesh().time();
    return
        window_ > 0
      ? label(std::ceil((time.value() - begin_)/window_ - 1e-5))
      : time.timeIndex();
}


Foam::label Foam::remoteMeshMotion::stepsLeft() const
{
    const Time& time = mesh().time();
    const scalar step = window_ > 0 ? window_ : time.deltaTValue();
    const scalar left = (time.endTime() - time).value()/step;
    if (commitEveryMove_ || !(left > -0.5 && left < labelMax/2))
    {
        return -1;
    }
    return label(left + 0.5);
}


void Foam::remoteMeshMotion::commit()
{
    if (trial_ >= 0)
    {
        session_->commit(left_);
        committed_ = trial_;
        first_ = min(first_, trial_);
        trial_ = -1;
    }
}


void Foam::remoteMeshMotion::goBack()
{
    const Time& time = mesh().time();
    const scalar begin = time.value() - time.deltaTValue();
    if (window_ > 0 || first_ < stepNow())
    {
        FatalErrorInFunction
            << "the time went back from " << Foam::name(last_) << " to "
            << Foam::name(begin)
            << ", before steps that are committed: the steps between are one "
            << "window of a coupling" << nl
            << "    give its length in " << typeName << "Coeffs: "
            << "couplingWindow " << Foam::name(last_ - begin) << ';'
            << exit(FatalError);
    }
    window_ = last_ - begin;
    begin_ = begin;
    trial_ = committed_ = -1;
    first_ = labelMax;
    Info<< "remoteMeshMotion: the time went back by " << Foam::name(window_)
        << " s, the coupling's window: from now on it is one step" << endl;
    session_->discard();
    session_.reset(new remoteSession(coeffDict()));
    open();
}


void Foam::remoteMeshMotion::beginMove()
{
    const label now = stepNow();
    if (trial_ >= 0 && now > trial_)
    {
        commit();
    }
    else if (now <= committed_ && !commitEveryMove_)
    {
        goBack();
    }
}


void Foam::remoteMeshMotion::setCellDisplacement()
{
    if (!cellDisplacement_)
    {
        return;
    }
    const pointField& from = points0();
    const pointField to(curPoints());
    volVectorField& field = *cellDisplacement_;
    const cellList& cells = mesh().cells();
    vectorField& inner = field.primitiveFieldRef();
    forAll(inner, celli)
    {
        const cell& c = cells[celli];
        inner[celli] =
            c.centre(to, mesh().faces()) - c.centre(from, mesh().faces());
    }
    for (fvPatchVectorField& patch : field.boundaryFieldRef())
    {
        const polyPatch& faces = patch.patch().patch();
        forAll(patch, i) // none where the patch is empty
        {
            patch[i] = faces[i].centre(to) - faces[i].centre(from);
        }
    }
}


#ifdef OPENFOAM
Foam::remoteMeshMotion::remoteMeshMotion
(
    const polyMesh& mesh,
    const IOdictionary& dict
)
:
    remoteMeshMotion(mesh, dict, ofZone(mesh, dict))
{}


Foam::remoteMeshMotion::remoteMeshMotion
(
    const polyMesh& mesh,
    const IOdictionary& dict,
    const std::unique_ptr<IOdictionary>& ofZone
)
:
    displacementMotionSolver(mesh, ofZone ? *ofZone : dict, typeName),
#else
Foam::remoteMeshMotion::remoteMeshMotion
(
    const word& name,
    const polyMesh& mesh,
    const dictionary& dict
)
:
    displacementMotionSolver(name, mesh, dict, typeName),
#endif
    zoneName_(zoneName(dict)),
    zone_(cellsOf(mesh, zoneName_)),
    patches_(own(), checked(dict, coeffDict())),
    evaluates_(isSecond(coeffDict(), "evaluation", {"server", "client"})),
    remoteMesh_
    (
        own(), ofOwn(evaluates_ ? points0() : mesh.points()), patches_
    ),
    commitEveryMove_
    (
        isSecond(coeffDict(), "commit", {"timeStep", "everyMove"})
    ),
    window_(coeffDict().lookupOrDefault<scalar>("couplingWindow", 0)),
    begin_(mesh.time().value()),
    trial_(-1),
    committed_(-1),
    first_(labelMax),
    last_(0),
    left_(-1)
{
    isSecond(coeffDict(), "atEnd", {"keep", "discard"});
    isSecond(coeffDict(), "onRefusal", {"fail", "keep"});
    patches_.check(pointDisplacement_, coeffDict());
    session_.reset(new remoteSession(coeffDict()));
    if (!resume())
    {
        offset_ = ofOwn(mesh.points()) - ofOwn(points0());
        if (evaluates_)
        {
            offset_ = Zero;
        }
        open();
    }
    accepted_ = ofOwn(mesh.points()) - ofOwn(points0());
    if (!mesh.foundObject<volVectorField>("cellDisplacement"))
    {
        cellDisplacement_ = newCellDisplacement(mesh);
        setCellDisplacement();
    }
}


Foam::remoteMeshMotion::~remoteMeshMotion()
{
    commit();
}


Foam::tmp<Foam::pointField> Foam::remoteMeshMotion::curPoints() const
{
    return points0() + pointDisplacement_.primitiveField();
}


void Foam::remoteMeshMotion::solve()
{
    beginMove();
    pointDisplacement_.correctBoundaryConditions();

    label nMoving = 0;
    const int64_t* moving = session_->movingNodes(nMoving);
    scalarField rows, answer;
    const vectorField moved
    (
        ofOwn(patches_.moved(pointDisplacement_, points0())()) - offset_
    );
    remoteMesh_.toNodes(moved, nMoving, moving, rows);
    if (session_->move(rows, answer))
    {
        session_->report();
        accepted_.setSize(own().nPoints());
        accepted_ = Zero;
        remoteMesh_.toPoints(answer, accepted_);
        accepted_ += offset_;
    }
    toAll(accepted_, pointDisplacement_.primitiveFieldRef());
    setCellDisplacement();
    trial_ = stepNow();
    last_ = mesh().time().value();
    left_ = stepsLeft();
    if (commitEveryMove_)
    {
        commit();
    }
}


void Foam::remoteMeshMotion::refuseTopology() const
{
    FatalErrorInFunction
        << "the topology of the mesh has changed, which remoteMeshMotion "
        << "cannot follow: restart from a written time" << exit(FatalError);
}


bool Foam::remoteMeshMotion::save() const
{
    const fileName path(folder(mesh().time().timeName()));
    if (session_->isRefused())
    {
        rm(path/"state"); // of an earlier iteration: no step ends here
        return true;
    }
    if (Pstream::master())
    {
        mkDir(path);
    }
    // written before the state, since a restart looks for the state
    session_->save(path/"credentials");
    List<scalarList> rows(trial_ < 0 ? 0 : Pstream::nProcs());
    if (trial_ >= 0)
    {
        rows[Pstream::myProcNo()] = session_->rows();
        Pstream::gatherList(rows);
    }
    if (Pstream::master())
    {
        OFstream state(path/"state");
        state.precision(17);
        state
            << "step " << session_->step() + (trial_ < 0 ? 0 : 1) << ";\n"
            << "processors " << Pstream::nProcs() << ";\n"
            << "settings " << digest() << ";\n";
        if (window_ > 0)
        {
            state << "couplingWindow " << window_ << ";\n";
        }
        if (trial_ >= 0)
        {
            state << "trial " << rows << ";\n";
        }
    }
    return true;
}
