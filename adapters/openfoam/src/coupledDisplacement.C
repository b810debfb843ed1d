// SPDX-License-Identifier: GPL-3.0-or-later
#ifdef OPENFOAM // not for the Foundation's OpenFOAM

#include "coupledDisplacement.H"
#include "addToRunTimeSelectionTable.H"
#include "pointPatchFields.H"

namespace Foam
{
    makePointPatchTypeField(pointPatchVectorField, coupledDisplacement);
}


Foam::coupledDisplacement::coupledDisplacement
(
    const pointPatch& p,
    const DimensionedField<vector, pointMesh>& iF
)
:
    fixedValuePointPatchField<vector>(p, iF),
    settings_(),
    link_()
{}


Foam::coupledDisplacement::coupledDisplacement
(
    const pointPatch& p,
    const DimensionedField<vector, pointMesh>& iF,
    const dictionary& dict
)
:
    fixedValuePointPatchField<vector>(p, iF, dict),
    settings_(dict),
    link_(std::make_shared<couplingLink>(dict))
{
    settings_.remove("value");
    settings_.remove("type");
}


Foam::coupledDisplacement::coupledDisplacement
(
    const coupledDisplacement& other,
    const pointPatch& p,
    const DimensionedField<vector, pointMesh>& iF,
    const pointPatchFieldMapper& mapper
)
:
    fixedValuePointPatchField<vector>(other, p, iF, mapper),
    settings_(other.settings_),
    link_(other.link_)
{}


Foam::coupledDisplacement::coupledDisplacement
(
    const coupledDisplacement& other,
    const DimensionedField<vector, pointMesh>& iF
)
:
    fixedValuePointPatchField<vector>(other, iF),
    settings_(other.settings_),
    link_(other.link_)
{}


void Foam::coupledDisplacement::updateCoeffs()
{
    if (updated())
    {
        return;
    }
    const polyMesh& mesh = internalField().mesh()();
    const fvMesh& flow = refCast<const fvMesh>(mesh);
    if (link_ && link_->due(flow))
    {
        Field<vector>::operator=(link_->exchange(flow, patch().index()));
    }
    fixedValuePointPatchField<vector>::updateCoeffs();
}


void Foam::coupledDisplacement::write(Ostream& os) const
{
    pointPatchField<vector>::write(os);
    settings_.write(os, false);
    writeEntry("value", os);
}


#endif
