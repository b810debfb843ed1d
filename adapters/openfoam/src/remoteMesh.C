// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteMesh.H"
#include "releases.H"
#include "emptyPolyPatch.H"
#include "globalIndex.H"
#include "globalMeshData.H"
#include "syncTools.H"
#include "wedgePolyPatch.H"

Foam::vector Foam::remoteMesh::meanOf
(
    const face& f,
    const vectorField& values,
    const edge& diagonal
)
{
    if (diagonal[0] >= 0)
    {
        return 0.5*(values[diagonal[0]] + values[diagonal[1]]);
    }
    vector sum(Zero);
    for (const label pointi : f)
    {
        sum += values[pointi];
    }
    return sum/f.size();
}


Foam::edge Foam::remoteMesh::diagonal(const face& f, const pointField& base)
{
    if (f.size() == 4)
    {
        vectorField normals(4);
        forAll(f, i)
        {
            const vector after = base[f.nextLabel(i)] - base[f[i]];
            normals[i] = after ^ (base[f.prevLabel(i)] - base[f[i]]);
        }
        const vector area(sum(normals));
        forAll(f, i)
        {
            if ((normals[i] & area) < 0)
            {
                return edge(f[i], f[(i + 2) % 4]);
            }
        }
    }
    return edge(-1, -1);
}


void Foam::remoteMesh::findDimension()
{
    const Vector<label>& directions = mesh_.geometricD();
    DynamicList<label> axes(3);
    for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt)
    {
        if (directions[cmpt] > 0)
        {
            axes.append(cmpt);
        }
    }
    if (axes.size() < 2)
    {
        FatalErrorInFunction
            << "the mesh has " << axes.size() << " dimension(s): "
            << "remoteMeshMotion moves meshes of two or three"
            << exit(FatalError);
    }
    axes_.transfer(axes);
    forAllReverse(mesh_.boundaryMesh(), patchi)
    {
        if (isA<wedgePolyPatch>(mesh_.boundaryMesh()[patchi]))
        {
            wedge_ = patchi;
        }
    }
}


Foam::labelList Foam::remoteMesh::planeFaces(const bool front) const
{
    DynamicList<label> faces(mesh_.nCells());
    for (const polyPatch& pp : mesh_.boundaryMesh())
    {
        if (!isA<emptyPolyPatch>(pp) && !isA<wedgePolyPatch>(pp))
        {
            continue;
        }
        forAll(pp, i)
        {
            const label facei = pp.start() + i;
            const scalar area = mesh_.faceAreas()[facei][thinAxis()];
            if (front ? area > 0 : area < 0)
            {
                faces.append(facei);
            }
        }
    }
    return faces;
}


Foam::boolList Foam::remoteMesh::pointsOf(const labelList& faces) const
{
    boolList on(mesh_.nPoints(), false);
    for (const label facei : faces)
    {
        UIndirectList<bool>(on, mesh_.faces()[facei]) = true;
    }
    return on;
}


void Foam::remoteMesh::setSlopes
(
    const labelList& faces,
    const boolList& onOther
)
{
    vector slope(sum(vectorField(mesh_.faceAreas(), faces)));
    reduce(slope, sumOp<vector>()); // the same bits on all ranks
    slope /= -slope[thinAxis()];
    slope[thinAxis()] = 0;
    const boolList on(pointsOf(faces));
    forAll(on, pointi)
    {
        if (on[pointi] && !onOther[pointi])
        {
            slopes_[pointi] = slope;
        }
    }
}


void Foam::remoteMesh::numberPlane()
{
    const labelList plane(planeFaces()), other(planeFaces(false));
    const boolList isFront(pointsOf(plane)), isBack(pointsOf(other));
    pointNode_ = -1;
    label nAxis = 0;
    forAll(isFront, pointi)
    {
        if (isFront[pointi])
        {
            pointNode_[pointi] = nodePoint_.size();
            nodePoint_.append(pointi);
            nAxis += isBack[pointi];
        }
    }
    label nPairs = 0;
    for (const edge& e : mesh_.edges())
    {
        const label front = isFront[e[0]] ? e[0] : e[1];
        const label back = e.otherVertex(front);
        if
        (
            isFront[front] && !isBack[front]
         && isBack[back] && !isFront[back]
        )
        {
            pointNode_[back] = pointNode_[front];
            ++nPairs;
        }
    }
    if
    (
        plane.size() != mesh_.nCells()
     || nPairs + nAxis != nodePoint_.size()
     || contains(pointNode_, -1)
    )
    {
        FatalErrorInFunction
            << "a 2D mesh must have one layer of cells between its empty or "
            << "wedge patches, with every point on either; got " << plane.size()
            << " of their faces on one side of " << mesh_.nCells()
            << " cells, and " << nPairs << " edges across it for "
            << mesh_.nPoints() << " points" << exit(FatalError);
    }
    if (wedge_ >= 0)
    {
        slopes_.setSize(mesh_.nPoints(), Zero);
        setSlopes(plane, isBack);
        setSlopes(other, isFront);
    }
}


void Foam::remoteMesh::addMiddle(const label facei, const pointField& base)
{
    faceNode_.insert(facei, nodePoint_.size() + middles_.size());
    middles_.append(facei);
    diagonals_.append(diagonal(mesh_.faces()[facei], base));
}


void Foam::remoteMesh::numberGlobally()
{
    labelList pointIds, mine;
    const globalIndex points(mesh_.globalData().mergePoints(pointIds, mine)());
    const globalIndex faces(mesh_.nFaces()), cells(mesh_.nCells());
    // a face between two ranks has one number: the lower of the two
    labelList faceIds(mesh_.nFaces());
    forAll(faceIds, facei)
    {
        faceIds[facei] = faces.toGlobal(facei);
    }
    syncTools::syncFaceList(mesh_, faceIds, minEqOp<label>());

    const int64_t firstFace = points.size();
    const int64_t firstCell = firstFace + faces.size();
    globalIds_.resize(nodePoint_.size() + middles_.size() + cellNode_.size());
    forAll(nodePoint_, node)
    {
        globalIds_[node] = pointIds[nodePoint_[node]];
    }
    for (const label facei : faceNode_.toc())
    {
        globalIds_[faceNode_[facei]] = firstFace + faceIds[facei];
    }
    for (const label celli : cellNode_.toc())
    {
        globalIds_[cellNode_[celli]] = firstCell + cells.toGlobal(celli);
    }
}


void Foam::remoteMesh::setPoints(const pointField& base)
{
    const label nNodes = nodePoint_.size() + middles_.size() + cellNode_.size();
    points_.resize(std::size_t(nNodes)*axes_.size());
    const auto set = [&](const label node, const point& p)
    {
        forAll(axes_, i)
        {
            points_[std::size_t(node)*axes_.size() + i] = p[axes_[i]];
        }
    };
    forAll(nodePoint_, node)
    {
        set(node, base[nodePoint_[node]]);
    }
    // the other rank adds in another order, so its mean may differ in the last
    // bit
    pointField middles(mesh_.nFaces() - mesh_.nInternalFaces(), Zero);
    forAll(middles_, i)
    {
        const label facei = middles_[i];
        const point middle = meanOf(mesh_.faces()[facei], base, diagonals_[i]);
        set(faceNode_[facei], middle);
        if (!mesh_.isInternalFace(facei))
        {
            middles[facei - mesh_.nInternalFaces()] = middle;
        }
    }
    if (Pstream::parRun() && dimension() == 3)
    {
        syncTools::syncBoundaryFacePositions(mesh_, middles, minEqOp<point>());
        for (const label facei : middles_)
        {
            if (!mesh_.isInternalFace(facei))
            {
                set
                (
                    faceNode_[facei],
                    middles[facei - mesh_.nInternalFaces()]
                );
            }
        }
    }
    forAll(centres_, i)
    {
        set(nodePoint_.size() + middles_.size() + i, centres_[i]);
    }
}


Foam::boolList Foam::remoteMesh::pointsOf(const polyPatch& pp) const
{
    boolList on(mesh_.nPoints(), false);
    UIndirectList<bool>(on, pp.meshPoints()) = true;
    if (Pstream::parRun())
    {
        // a rank may hold a point of the patch without a face of it
        syncTools::syncPointList(mesh_, on, orEqOp<bool>(), false);
    }
    return on;
}


std::vector<int64_t> Foam::remoteMesh::axisNodes() const
{
    std::vector<int64_t> nodes;
    const boolList isBack(pointsOf(planeFaces(false)));
    forAll(nodePoint_, node)
    {
        if (isBack[nodePoint_[node]])
        {
            nodes.push_back(node);
        }
    }
    return nodes;
}


void Foam::remoteMesh::addPatch(patch&& added)
{
    if (returnReduce(added.nodes.size() > 0, orOp<bool>()))
    {
        patches_.push_back(std::move(added));
    }
}


void Foam::remoteMesh::addPatches(const remotePatches& roles)
{
    forAll(mesh_.boundaryMesh(), patchi)
    {
        const polyPatch& pp = mesh_.boundaryMesh()[patchi];
        if (patchi == wedge_)
        {
            addPatch({pp.name(), "symmetry", axisNodes()});
        }
        if (roles.role(patchi).empty())
        {
            continue;
        }
        patch added{pp.name(), roles.role(patchi), {}};
        const boolList on(pointsOf(pp));
        boolList done(nodePoint_.size(), false);
        forAll(on, pointi)
        {
            const label node = pointNode_[pointi];
            if (on[pointi] && !done[node])
            {
                done[node] = true;
                added.nodes.push_back(node);
            }
        }
        forAll(pp, i)
        {
            if (faceNode_.found(pp.start() + i))
            {
                added.nodes.push_back(faceNode_[pp.start() + i]);
            }
        }
        addPatch(std::move(added));
    }
}


Foam::remoteMesh::remoteMesh
(
    const polyMesh& mesh,
    const pointField& base,
    const remotePatches& roles
)
:
    mesh_(mesh),
    pointNode_(identity(mesh.nPoints())),
    wedge_(-1)
{
    findDimension();
    if (dimension() == 2)
    {
        numberPlane();
    }
    else
    {
        nodePoint_ = pointNode_;
    }
    numberCentres(base);
    if (Pstream::parRun())
    {
        numberGlobally();
    }
    setPoints(base);
    addCells();
    addPatches(roles);
}


void Foam::remoteMesh::toNodes
(
    const vectorField& pointValues,
    const label nNodes,
    const int64_t* nodes,
    scalarField& rows
) const
{
    rows.setSize(nNodes*dimension());
    for (label i = 0; i < nNodes; ++i)
    {
        const label node = label(nodes[i]);
        if (node < 0 || node >= nodePoint_.size() + middles_.size())
        {
            FatalErrorInFunction
                << "the session says that node " << node << " moves: this "
                << "mesh has " << nodePoint_.size() + middles_.size()
                << " that can. Is it the session of another mesh?"
                << exit(FatalError);
        }
        const label middle = node - nodePoint_.size();
        const vector value
        (
            middle < 0
          ? pointValues[nodePoint_[node]]
          : meanOf
            (
                mesh_.faces()[middles_[middle]],
                pointValues,
                diagonals_[middle]
            )
        );
        forAll(axes_, j)
        {
            rows[i*dimension() + j] = value[axes_[j]];
        }
    }
}


void Foam::remoteMesh::toPoints
(
    const scalarField& rows,
    vectorField& pointValues
) const
{
    if (rows.size() != size()*dimension())
    {
        FatalErrorInFunction
            << "the session has " << rows.size()/dimension() << " nodes, this "
            << "mesh " << size() << ": is it the session of another mesh?"
            << exit(FatalError);
    }
    forAll(pointNode_, pointi)
    {
        vector& value = pointValues[pointi];
        const vector before(value);
        forAll(axes_, j)
        {
            value[axes_[j]] = rows[pointNode_[pointi]*dimension() + j];
        }
        if (slopes_.size())
        {
            value[thinAxis()] += slopes_[pointi] & (value - before);
        }
    }
}


Foam::label Foam::remoteMesh::cellOf
(
    const std::string& type,
    const int64_t index
) const
{
    const auto found = cells_.find(type);
    const bool known =
        found != cells_.end() && index >= 0
     && std::size_t(index) < found->second.cells.size();
    return known ? found->second.cells[index] : -1;
}
